"""What the core does without: kept tested and reachable, handed in by entry points, imported by no room."""
