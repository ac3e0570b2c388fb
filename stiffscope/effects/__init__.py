"""Effects that a nominal model may lack, one module each; `vocabulary` discovers them."""
