"""Skeletons: calibration of a subject, and its joints in every frame."""
