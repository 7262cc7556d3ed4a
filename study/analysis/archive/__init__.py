"""Archives of runs: one file to deposit, with what is needed to read the tables and to compute them again."""
