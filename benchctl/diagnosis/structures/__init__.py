"""What is left and has no name: modelled by the simplest shape over a coordinate, and stated with its formula."""
