"""Registration of range scans: ICP and the NDT (chapter 7)."""
