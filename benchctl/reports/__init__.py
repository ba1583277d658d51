"""What people read: figures, pages, and the results that they are made of."""
