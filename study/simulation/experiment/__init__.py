"""The experiment: conditions, designs, configs, and the draws of each trial."""
