"""Work against precision: what error a scene's settings have, what they cost, and which to take."""
