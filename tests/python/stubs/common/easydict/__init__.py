class EasyDict(dict):
    def __init__(self, values=None, **more):
        super().__init__()
        self.update(values or {}, **more)

    def __setattr__(self, name, value):
        if isinstance(value, dict) and not isinstance(value, EasyDict):
            value = EasyDict(value)
        super().__setattr__(name, value)
        super().__setitem__(name, value)

    __setitem__ = __setattr__

    def update(self, values=None, **more):
        for name, value in {**(values or {}), **more}.items():
            self[name] = value
