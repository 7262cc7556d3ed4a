"""Form of a measured sphere: the zone between two concentric spheres that holds all points."""
