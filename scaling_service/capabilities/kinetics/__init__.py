"""Forces of the ground on the feet, and what they and a motion ask of the joints: inverse dynamics."""
