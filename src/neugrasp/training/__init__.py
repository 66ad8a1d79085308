"""One training loop for any network: `trainer` reads from top to bottom.

`networks` says what a network must bring, `recipes` how ours is trained, `module` what a step computes. A
run goes on to the bit where it stopped; whatever it depends on is in its state.
"""
