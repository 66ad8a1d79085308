"""The paper's network and training step as one would first write them, to measure the product against."""
