//! Volumes and transfer functions: readers, gradients, the made vessel tree.
