"""Drawing: maps, lines, nodes, comparisons."""
