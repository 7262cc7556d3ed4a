"""Recordings: markers become poses, joints and skeletons."""
