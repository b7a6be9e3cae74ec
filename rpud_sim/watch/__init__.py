"""Watch a drill or a bag: live page in the browser, view in the terminal."""
