"""The refracting surface: each module finds the incidence point, with its partial derivatives."""
