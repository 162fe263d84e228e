//! Three agents that close the visualization-perception-action loop.
