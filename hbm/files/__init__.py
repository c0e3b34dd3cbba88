"""Results on disk: tables, figures with the numbers of their curves, and pages that open offline."""
