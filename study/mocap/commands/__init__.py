"""The commands on recordings, one per file; each calls the library, prints the results and names the files written."""
