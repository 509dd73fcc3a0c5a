"""From residuals to a fit: least squares, noise, uncertainty, what the data do not determine. No physics."""
