"""Text formats of markers, one reader a file: each takes the lines of a file and returns its contents."""
