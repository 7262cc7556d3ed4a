"""Numbers in, numbers with their Monte-Carlo errors out."""
