"""Space: images of tiles, the panorama, textured triangles."""
