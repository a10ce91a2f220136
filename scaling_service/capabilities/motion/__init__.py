"""The motion of recordings with a model that exists: inverse kinematics with its uncertainty."""
