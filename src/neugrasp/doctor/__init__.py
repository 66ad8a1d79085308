"""Looking at a capture before anything is predicted from it."""
