"""Planning of motions for `point_to_point`: model, program, profiles; no component."""
