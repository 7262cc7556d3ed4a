"""Phase 2: a skeleton in every frame, from a calibration."""
