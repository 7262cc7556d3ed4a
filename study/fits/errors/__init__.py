"""Points and a sphere in, bounds and intervals out: how far the sphere may be from the true one."""
