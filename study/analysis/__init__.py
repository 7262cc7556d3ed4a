"""Tables in, tables out: performance measures with their Monte-Carlo error."""
