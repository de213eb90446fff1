"""Web pages on the product store: read-only, without network; started by ``gravcal browse``.

store_index  content of the store: events with their state, chains of stages, records
series     variables of a product; a series at the resolution of the screen; differences and spectra
plots      figures (Bokeh) with the data the page asks for
timeline   results over the years, with trims and printed values
pages      one function for each page
app        addresses, who may ask for them; the server
"""
