"""The engine in C, precompiled for processors and compiled at run time for GPUs: laws translated from Python
(a user's own are compiled when they are used), the library and its binding."""
