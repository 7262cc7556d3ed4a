"""Pictures of skeletons: figures, videos and an interactive page."""
