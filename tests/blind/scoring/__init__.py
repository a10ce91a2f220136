"""From results and labels to figures."""
