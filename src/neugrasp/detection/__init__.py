"""From an observation to ranked grasps.

`contract` and `registry` are what a detector of one's own needs; `detector` is NeuGrasp; `decode` and
`hand_check` choose grasps of the head, `candidates` and `judge` those of an evaluator; `steering` leaves
out what is not wanted.
"""
