"""Drive signals: waveforms for people (such as `Sawtooth`) and the segment table for kernels (`Drive`).

A waveform is anything that fulfils the protocol `signal.Waveform`; a simulation needs no more of it than its
method ``drive(duration)``. A user's own waveform is a class in the user's file that builds its table with
`pieces.assemble` or `pieces.repeat`, as `shapes` and `periodic` do.

Values are in volts, or in metres where ``unit="m"``: the same shapes move a piezo and the base of a
spring-pulled slider.
"""
