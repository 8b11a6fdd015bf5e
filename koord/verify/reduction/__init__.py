"""What a claim cannot depend on is left out before engines are asked. [T-CONE]"""
