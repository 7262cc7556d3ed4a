"""Recordings of moving bodies: marker files in, joints and a moving skeleton out."""
