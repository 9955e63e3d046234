"""Whether a track and its covariances can be trusted."""
