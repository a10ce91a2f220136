"""The blind bank by OpenSim: real movements, a model of 35 coordinates, the same steps, files and scoring."""
