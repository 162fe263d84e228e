//! Bus, actors, lifecycle, health: what every process is built on.
