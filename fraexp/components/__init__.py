"""What plugins provide: parameters, the kinds of component, and how they are found."""
