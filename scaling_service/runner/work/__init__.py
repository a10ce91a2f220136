"""One module for each row of the table of kinds; each has ``work(request, inputs, outputs, progress)``."""
