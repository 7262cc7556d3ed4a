"""Files and arrays of points in, `Samples` out, with the moments and the information that they carry."""
