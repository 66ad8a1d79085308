"""From an observation to ranked grasps.

`contract` and `registry` are what a detector of one's own needs; `detector` is NeuGrasp; `decode` and
`collision_filter` choose grasps of the head, `candidates` and `judge` those of an evaluator; `steering`
leaves out what is not wanted.
"""
