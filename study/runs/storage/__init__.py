"""Files of a run: the folder, its tables and their schemas, parts, the lock."""
