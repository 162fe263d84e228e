//! The launch-file language, the supervisor and the supergaussian command.
