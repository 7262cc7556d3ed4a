"""Files of a run: the folder, its tables and their schemas, the parts, the lock."""
