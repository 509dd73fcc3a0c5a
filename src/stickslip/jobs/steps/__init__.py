"""Steps of a job: each module registers the kinds of its steps in `registry.steps`, as `StepKind`s."""
