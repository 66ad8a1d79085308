"""What a prediction looks like to a person: one HTML file."""
