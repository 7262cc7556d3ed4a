"""What a study is: its config, its cells, its random streams, and the one function that runs in a worker."""
