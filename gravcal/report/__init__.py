"""Reports: figures and pages made from products only."""
