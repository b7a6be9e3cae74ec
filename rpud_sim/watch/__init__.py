"""Watch a drill or a bag: pages in the browser."""
