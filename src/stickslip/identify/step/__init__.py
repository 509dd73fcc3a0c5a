"""Steps: the stage with the end-effector fixed to it."""
