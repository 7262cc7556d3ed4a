"""Workers: threads, processes or a Dask cluster that compute units."""
