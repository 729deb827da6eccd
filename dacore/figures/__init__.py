"""One figure a file: data in, Figure out."""
