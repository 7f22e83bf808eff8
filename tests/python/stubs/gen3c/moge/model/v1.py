class MoGeModel:
    is_loaded = False

    @classmethod
    def from_pretrained(cls, name):
        assert name == "Ruicheng/moge-vitl"
        model = cls()
        model.is_loaded = True
        return model

    def to(self, device):
        return self
