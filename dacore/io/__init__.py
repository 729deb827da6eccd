"""Scenes, snapshots, fields, meshes: reading, and writing atomically."""
