"""Statistics of simulated errors, each with its Monte-Carlo standard error."""
