"""Web pages on the product store: read-only, without network; started by ``gravcal browse``."""
