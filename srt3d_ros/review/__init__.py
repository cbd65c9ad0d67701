"""Review a recording without a viewer or a screen: figures, report, comparison, export."""
