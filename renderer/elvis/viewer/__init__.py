"""Looking at data: a session with a scene, a process that draws it, a page in a browser."""
