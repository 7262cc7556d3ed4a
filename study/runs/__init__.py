"""Bytes and processes: schemas, the run folder, provenance, the plan, the runner."""
