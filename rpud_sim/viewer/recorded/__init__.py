"""A recorded run in the browser: its overview, any part of it, and the page that shows them."""
