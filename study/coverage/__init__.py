"""Coverage study: the share of data sets in which intervals hold the truth, over all fits and over the ok ones."""
