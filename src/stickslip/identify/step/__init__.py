"""Step responses of the stage with the end-effector fixed to it: identification."""
