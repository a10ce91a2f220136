"""How the persons move."""
