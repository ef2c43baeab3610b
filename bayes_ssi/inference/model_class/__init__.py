"""A model class: structures and priors, together with the data that they are to explain."""
