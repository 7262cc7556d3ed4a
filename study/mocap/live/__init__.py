"""Joints from a stream of frames: lines of markers in, centres that improve as frames come out."""
