"""Charts, figures, pictures, tables and the HTML report of stored runs."""
