"""What a method costs the muscles: lengths, moment arms and joint moments by method."""
