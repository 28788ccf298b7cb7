"""Scenes as others write them: plans in JSON, ROS maps, meshes, PointNav episodes. Each module has a `load`."""
