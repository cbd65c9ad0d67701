"""Review a recording without a viewer or a screen: figures and a report."""
