"""Classical control laws, one file each; ``table`` lists them."""
