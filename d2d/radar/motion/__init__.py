"""The motion between two scans, and its covariance."""
