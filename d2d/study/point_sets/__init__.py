"""Registration of range scans: ICP and the NDT (appendix B)."""
