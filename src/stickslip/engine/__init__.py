"""The precompiled engine in C: laws translated from Python, the library and its binding."""
