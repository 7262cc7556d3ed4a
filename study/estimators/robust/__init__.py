"""Outliers and copies among the points, and the fit that leaves the outliers out."""
