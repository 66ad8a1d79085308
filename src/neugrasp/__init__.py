"""NeuGrasp: surfaces and 6-DoF grasps from a few RGB photos of a table."""
