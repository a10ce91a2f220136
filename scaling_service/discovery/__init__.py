"""Where simulation and measurement disagree, which effect is missing, and what it explains once added."""
