"""Spheres and samples on them: arrays only, no config, no files, no study."""
