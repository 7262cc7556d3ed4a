"""Points and a sphere in, a status out: what residuals show of shape, noise, memory and outliers."""
