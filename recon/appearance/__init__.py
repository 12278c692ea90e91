"""How the object looks: colours and a texture for the procedural mesh, from photos or from a coloured shape."""
