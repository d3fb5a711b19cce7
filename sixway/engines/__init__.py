"""Files for game engines: named packings, flipbooks, their sidecar, and a validator of what others wrote."""
