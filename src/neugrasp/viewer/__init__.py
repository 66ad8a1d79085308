"""A capture, a prediction or a round of decluttering to walk around in, in the browser."""
