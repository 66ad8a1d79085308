"""The paper's network as one would first write it: what the package's network is compared with."""
