//! Materials, lights, transfer function, camera: what a picture is of.
