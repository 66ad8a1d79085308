"""The paper's figures, drawn from a model and photos of one's own."""
