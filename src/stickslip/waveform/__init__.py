"""Drive signals: what they are (`shapes`, `sequence`) and the table that kernels read (`drive`)."""
