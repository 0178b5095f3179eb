"""What to do beyond the sentence: a line for each error and remark that an artist may meet.

`troubleshooting.py` makes the manual's page of it. The sentences are those of the code; tests find
one that is not there any more, and one of the code that is neither here nor among `NOT_MET`.
"""

from __future__ import annotations

from typing import NamedTuple


class Advice(NamedTuple):
    """A sentence, by its template, and what to do, in each language.

    alike : further sentences, or reasons that stand in this one, for which the same is to be done
    """

    template: str
    en: str
    ja: str
    alike: tuple[str, ...] = ()

    @property
    def templates(self) -> tuple[str, ...]:
        """All sentences that are told of here."""
        return self.template, *self.alike


class Section(NamedTuple):
    """A heading in each language, and the advice under it."""

    en: str
    ja: str
    advice: tuple[Advice, ...]


RIG = Section(
    "The rig",
    "リグ",
    (
        Advice(
            "The rig has no {noun}: {remedy}.",
            "Press Add Rig, or give an object the role in the panel Object.",
            "「リグを追加」を押すか、「オブジェクト」パネルでオブジェクトに役割を設定します。",
        ),
        Advice(
            "The rig has a {noun} already.",
            "Make Part makes what is missing. To have another one, delete it first.",
            "「部品を作る」は足りないものを作ります。別のものにするには、先に削除します。",
        ),
        Advice(
            "Too little is left of the rig to tell where the part stands: press Undo, or remove the"
            " rig and add it again.",
            "Picture, plate and display each stand where the other two and the glass ask for them.",
            "絵、プレート、ディスプレイの位置は、それぞれ残りの二つとガラスから決まります。",
        ),
        Advice(
            "{owner} has the weight {weight:g}: set one above 0, or take it out of the list.",
            "A viewer with twice the weight is displaced half as much as the other.",
            "重みが2倍の視点では、像のずれがもう一方の半分になります。",
        ),
        Advice(
            "The viewer '{viewer}' is in the list {n} times: keep one.",
            "To let it count more, raise its weight.",
            "より重視するには、重みを上げます。",
        ),
        Advice(
            "{n} viewers are called '{viewer}', and results tell viewers by their names: rename all"
            " but one.",
            "A camera that is linked has the name that it has in its own file: rename the one of"
            " this file.",
            "リンクしたカメラの名前は元のファイルのものです。このファイルのカメラの名前を変更します。",
        ),
        Advice(
            "Two eyes are two viewers, and the rig has {n}: choose a left and a right one.",
            "Add a second camera beside the first, 64 mm to its right, and make it a viewer.",
            "1台目のカメラの右64 mmに2台目を追加し、視点にします。",
        ),
        Advice(
            "The viewer '{viewer}' is orthographic and is no eye: set it to Perspective.",
            "An orthographic camera sees from nowhere: it has no place for an eye.",
            "平行投影のカメラには、目の位置がありません。",
        ),
        Advice(
            "The viewers '{one}' and '{other}' look in different directions and are no pair of"
            " eyes: turn both to the picture.",
            "Give both cameras a Track To constraint with the picture as its target.",
            "両方のカメラに「トラック」コンストレイントを付け、絵をターゲットにします。",
        ),
        Advice(
            "The viewers '{one}' and '{other}' do not stand side by side and are no pair of eyes:"
            " move one to the right of the other.",
            "Eyes are about 64 mm apart, along the cameras' own X axis.",
            "両目の間隔は約64 mmで、カメラ自身のX軸に沿います。",
        ),
        Advice(
            "The plate '{plate}' stands between the viewers '{one}' and '{other}': move one of"
            " them to the other's side.",
            "One display shows its picture to one side of a plate.",
            "1枚のディスプレイが絵を見せられるのは、プレートの片側だけです。",
        ),
        Advice(
            "The rig has {n} {field} ({names}): keep one and set the others to None.",
            "The list in the panel Rig selects each of them.",
            "「リグ」パネルの一覧で、それぞれを選択できます。",
        ),
        Advice(
            "Select the copies of {names} that belong together, and nothing else, then make them a"
            " rig.",
            "After Shift D they are selected already. So press the button at once.",
            "Shift D の直後は、複製が選択されています。すぐにボタンを押します。",
        ),
        Advice(
            "'{name}' cannot be glass, for {why}: select your glass, or nothing for a ball.",
            "Cameras, lights and empties have no faces. Select a mesh.",
            "カメラ、ライト、エンプティには面がありません。メッシュを選択します。",
        ),
        Advice(
            "'{name}' is hidden{by} and cannot be glass: show it, or deselect it.",
            "Press Alt H in the viewport, and look at the eyes in the outliner.",
            "ビューポートで Alt H を押し、アウトライナーの目のアイコンも確かめます。",
        ),
        Advice(
            "'{name}' has no faces and cannot be glass: give it some, or deselect it.",
            "A curve gets faces by Bevel or Screw, a cloud of points by none.",
            "カーブはベベルやスクリューで面になります。点群は面になりません。",
        ),
        Advice(
            "'{name}' shows '{member}', which has a role of its own: set that to None first, in its"
            " file where it is linked.",
            "Or make it an object of the scene: Object > Apply > Make Instances Real.",
            "または、オブジェクト > 適用 > インスタンスを実体化 でシーンのオブジェクトにします。",
        ),
        Advice(
            "{name} is no closed body, but flat: give it a thickness, as by a Solidify modifier, or"
            " deselect it.",
            "Thicken, in the first panel, adds the modifier.",
            "最初のパネルのボタンで、ソリッド化モディファイアーを追加できます。",
        ),
        Advice(
            "'{name}' has the role {role}, but {why}: set its role to None.",
            "The role is in the panel Object. Only things with a surface are parts.",
            "役割は「オブジェクト」パネルにあります。面を持つものだけが部品になります。",
        ),
        Advice(
            "All viewers in the list are off: turn one on.",
            "The list of viewers is in the panel Rig. Each line begins with its checkbox.",
            "視点のリストは「リグ」パネルにあります。各行の先頭にチェックボックスがあります。",
        ),
        Advice(
            "The list of viewers has an entry without a camera: choose one, or remove the entry.",
            "Its camera was deleted. Minus, beside the list, removes the entry that is chosen.",
            "カメラが削除されています。リストの横のマイナスで、選択した項目を削除できます。",
        ),
        Advice(
            "The viewer '{viewer}' has no image of its own, but others have: choose one in the list"
            " of viewers, or take theirs away.",
            "Own Image, in the panel Rig, is of the viewer that is chosen in the list.",
            "「リグ」パネルの「専用の画像」は、リストで選択した視点のものです。",
        ),
        Advice(
            "The file '{file}' is the same for {n} viewers: put {mark} where their names are.",
            "The name of each viewer's camera takes that place, as in renders/Kiriko Left Eye.png.",
            "ファイル名のその部分が、視点のカメラの名前に置き換わります。",
        ),
        Advice(
            "The file '{file}' of the viewer '{viewer}' cannot be read: it is missing or broken.",
            "Its name has the name of the viewer's camera. The list of viewers has these.",
            "ファイル名には視点のカメラの名前が入ります。名前は視点のリストで確認できます。",
        ),
        Advice(
            "The scene '{scene}' rendered no image for the viewer '{viewer}' ({why}): render it by"
            " itself, which tells more.",
            "Switch to that scene and press F12. Esc stops a render, too.",
            "そのシーンに切り替えて F12 を押します。Esc もレンダーを止めます。",
        ),
        Advice(
            "Which scene the viewers shall see is not clear: name one of the other {n}.",
            "Choose it in the menu Render Pictures, in the panel Rig.",
            "「リグ」パネルの「絵をレンダー」のメニューで選択します。",
        ),
        Advice(
            "A grid of {n} heads: set 2 to {most} in all.",
            "Three by three are enough to begin with: each takes the time of one viewer.",
            "まずは3 x 3で十分です。1つごとに視点1つ分の時間がかかります。",
        ),
        Advice(
            "A photograph is taken from the first viewer's place: choose '{viewer}' in the list of"
            " viewers.",
            "What is off is kept along the first viewer's axes.",
            "ずれは最初の視点の軸に沿って記録されます。",
        ),
        Advice(
            "The result has no image '{image}': choose another in its menu.",
            "It was removed, or renamed. The conflict's goes where one viewer alone is on.",
            "削除されたか、名前が変わっています。オンの視点が一つだけになると、不一致の画像は消えます。",
        ),
        Advice(
            "The rig has no viewer '{name}': there are {names}.",
            "Viewers have the names of their cameras. One that is off is not there.",
            "視点の名前はカメラの名前です。オフの視点は含まれません。",
        ),
        Advice(
            "The viewer '{viewer}' is disabled or left out of the view layer, so that its place is"
            " unknown: enable it, or make it the scene's camera.",
            "Look for the checkbox of its collection in the outliner.",
            "アウトライナーで、コレクションのチェックボックスを確かめます。",
        ),
        Advice(
            "The viewer '{viewer}' is in no scene any more, as after deleting it: take it out of"
            " the list of viewers, or choose another camera.",
            "Undo brings it back, too.",
            "「元に戻す」でも戻ります。",
        ),
        Advice(
            "The viewer '{name}' is sheared or has no size: undo the uneven scale of it or of its"
            " parents.",
            "Select the camera and press Alt S; do the same with its parent.",
            "カメラを選択して Alt S を押します。親にも同じことをします。",
        ),
        Advice(
            "The viewer '{viewer}' is no camera: choose one.",
            "Choose it in the panel Rig, under Viewer.",
            "「リグ」パネルの「視点」で選びます。",
        ),
        Advice(
            "The viewer '{viewer}' is a panoramic or custom camera, whose image is no flat window:"
            " make it perspective or orthographic.",
            "The type is in the camera's properties, under Lens.",
            "カメラのプロパティの「レンズ」でタイプを変えます。",
        ),
        Advice(
            "The glass '{glass}' cuts the plane of the orthographic viewer '{viewer}': move it"
            " out.",
            "Move the camera back: its distance changes nothing in the image.",
            "カメラを後ろへ下げます。距離を変えても像は変わりません。",
        ),
        Advice(
            "The viewer '{viewer}' is inside the glass '{glass}': move it out.",
            "An eye is in air. Glass around it has to be hollow.",
            "目は空気の中にあります。まわりのガラスは中空でなければなりません。",
            (
                "With a Viewer Distance of {distance} the viewer would be inside {glass}: choose a"
                " longer one.",
            ),
        ),
        Advice(
            "'{name}' is in the rig '{rig}' already: select other glass, or remove that rig first.",
            "Each glass has one rig. A copy of the glass, by Shift D, can have another.",
            "一つのガラスのリグは一つです。Shift D で複製したガラスには、別のリグを追加できます。",
        ),
        Advice(
            "The scene has a {role} already ('{name}'): {remedy} first.",
            "It got its role by hand. Remove Rig takes only rigs that Add Rig made.",
            "手で役割を設定したオブジェクトです。「リグを削除」では消えません。",
        ),
        Advice(
            "The scene has no rig '{name}': there are {names}.",
            "Rigs have the names of their collections: see the outliner.",
            "リグの名前はコレクションの名前です。アウトライナーで確かめます。",
        ),
        Advice(
            "'{name}' is hidden: show it first.",
            "The list in the panel Rig shows it with the eye beside it.",
            "「リグ」パネルの一覧で、横の目のアイコンを押すと表示されます。",
        ),
        Advice(
            "There is no object '{name}' in this file any more.",
            "It was deleted or renamed meanwhile. Undo brings it back.",
            "その間に削除されたか、名前が変わりました。Ctrl Z で元に戻ります。",
        ),
        Advice(
            "'{name}' stays hidden, for its keyframes hide it in frame {frame}: delete the"
            " keyframes of its monitor or camera symbol, or go to a frame in which it is shown.",
            "A right click on the symbol in the outliner has Clear Keyframes.",
            "アウトライナーのアイコンを右クリックすると、キーフレームを削除できます。",
        ),
        Advice(
            "'{name}' stays hidden, for the strip '{strip}' of its nonlinear animation hides it in"
            " frame {frame}: mute the strip, or go to a frame in which it is shown.",
            "In the Nonlinear Animation editor, select the strip and press H.",
            "ノンリニアアニメーションのエディターでストリップを選択し、H キーを押します。",
        ),
        Advice(
            "The rig '{rig}' is linked from another file: unlink its collection, or make it local"
            " first.",
            "In the outliner, a right click on the collection has Unlink and Make Local.",
            "アウトライナーでコレクションを右クリックすると、リンク解除とローカル化があります。",
        ),
        Advice(
            "The rig with which {button} began is gone: begin again.",
            "It was deleted while the dialogue was open. Ctrl Z brings it back.",
            "ダイアログを開いている間に削除されました。Ctrl Z で元に戻ります。",
            alike=(
                "The scene with which {button} began is gone: begin again.",
                "{button} began in the scene '{scene}', and another one is shown: begin again.",
            ),
        ),
        Advice(
            "'{name}' stays hidden{by}: it is linked from another file, or driven.",
            "Show it in its own file, or make it local: Object > Relations > Make Local.",
            "元のファイルで表示するか、オブジェクト > 関係 > ローカル化 を使います。",
        ),
        Advice(
            "The rig is in the scene '{other}', too: unlink its collection '{rig}' there first.",
            "In that scene's outliner, a right click on the collection has Unlink.",
            "そのシーンのアウトライナーで、コレクションを右クリックしてリンクを解除します。",
            alike=(
                "The rig's '{name}' is in the scene '{other}', too: unlink it there first.",
                "The object '{name}' is an instance of the rig's collection '{rig}': delete it"
                " first.",
            ),
        ),
        Advice(
            "The axes of the viewer '{name}' are not orthonormal: remove shear from the camera.",
            "Parents with an uneven scale shear what they turn: Alt P takes the camera from them.",
            "親の不均一なスケールが原因です。Alt P で親子関係を解除します。",
        ),
        Advice(
            "{owner} sees nothing: its lens or orthographic scale has no size.",
            "Both are in the camera's properties. A driver may hold them.",
            "カメラのプロパティにあります。ドライバーが動かしていることもあります。",
            alike=(
                "{owner} has a place, lens or shift that is no finite number: look for a driver or"
                " a keyframe.",
            ),
        ),
        Advice(
            "{owner} has no pixels: set its resolution.",
            "The display's resolution is in the panel Object, the viewer's is the render's or its"
            " own.",
            "ディスプレイの解像度は「オブジェクト」パネルにあります。視点の解像度は、レンダーの解像度か「独自の解像度」です。",
        ),
    ),
)

GLASS = Section(
    "Glass",
    "ガラス",
    (
        Advice(
            "{owner} has no faces with an area: give it some, or set its role to None.",
            "In Edit Mode, Mesh > Clean Up > Degenerate Dissolve shows what is left.",
            "編集モードの メッシュ > クリーンアップ > 大きさ０を溶解 で確かめます。",
        ),
        Advice(
            "{owner} is no closed body, but flat: give it a thickness, as by a Solidify modifier,"
            " or set its role to None.",
            "Light has to come in and go out again: glass needs two sides.",
            "光は入って出ていきます。ガラスには両側の面が必要です。",
        ),
        Advice(
            "More than {most} glass solids around '{name}' touch, overlap or nest: join them by a"
            " Remesh modifier, or move them apart.",
            "Remesh: choose Voxel, with voxels smaller than the thinnest part.",
            "リメッシュでは「ボクセル」を選び、一番細い部分より小さいボクセルにします。",
        ),
        Advice(
            "{owner} has vertices that are not finite numbers: repair or remove them.",
            "A modifier or a script divided by nothing: turn modifiers off one by one.",
            "モディファイアーやスクリプトの計算の失敗です。モディファイアーを一つずつ無効にします。",
            alike=(
                "{owner} has vertices further than {furthest:.2g} m from the origin: move them"
                " nearer or remove them.",
            ),
        ),
        Advice(
            "'{name}' can have no modifier: turn it into a mesh.",
            "Object > Convert > Mesh does it.",
            "オブジェクト > 変換 > メッシュ を使います。",
            alike=("'{name}' is no mesh: turn it into one.",),
        ),
        Advice(
            "'{name}' has no faces that can be mended: draw some, or apply the modifiers that make"
            " them.",
            "Object > Apply > Visual Geometry to Mesh applies all modifiers.",
            "オブジェクト > 適用 > 表示形状をメッシュ化 で、モディファイアーをすべて適用します。",
        ),
        Advice(
            "'{name}' has no such faces any more: nothing is changed.",
            "The faces were mended before, or the mesh was edited since the checklist was drawn.",
            "その面はすでに修正されたか、チェックリストの表示後にメッシュが編集されています。",
        ),
        Advice(
            "'{name}' is linked from another file with its collection, and would not stay glass in"
            " this file: make it a library override first, by Object > Library Override > Make.",
            "The override has settings of its own, and follows its file in all else. Glass that is"
            " linked by itself becomes one by Add Rig.",
            "オーバーライドは自分の設定を持ち、それ以外は元のファイルに従います。単独でリンクした"
            "ガラスは、リグを追加するとオーバーライドになります。",
        ),
        Advice(
            "'{name}' is linked from another file: mend it there.",
            "Or make it local: Object > Relations > Make Local.",
            "または、オブジェクト > 関係 > ローカル化 を使います。",
        ),
    ),
)

PICTURE = Section(
    "The picture",
    "絵",
    (
        Advice(
            "The picture '{name}' shows no image: give its material an image texture, or choose an"
            " image in its Kiriko settings.",
            "Open Picture, beside the picture in the panel Rig, does both.",
            "「リグ」パネルの絵の横にある「絵を開く」で、両方を行えます。",
        ),
        Advice(
            "'{image}' cannot be {owner}, for it is in the Image Editor only: save it there (Image"
            " > Save As), and choose that file.",
            "A render result has no pixels of its own until it is saved.",
            "レンダー結果は、保存するまでピクセルを持ちません。",
        ),
        Advice(
            "The image '{image}' of {owner} cannot be read at its frame {number} from {file}: the"
            " file is missing or broken; find it again, or mend the frames in the image's texture.",
            "Frames, Start Frame and Offset stand at the Image Texture node, as for renders.",
            "フレーム、開始フレーム、オフセットは、レンダリングのときと同じく画像テクスチャノードにあります。",
        ),
        Advice(
            "The image '{image}' of {owner} cannot be read from the file {file}: the file is"
            " missing or broken; choose another or find it again.",
            "File > External Data > Find Missing Files looks for it.",
            "ファイル > 外部データ > 欠けたファイルを検索 で見つけます。",
            alike=("The image '{image}' of {owner} is empty, and has no file: choose another.",),
        ),
        Advice(
            "The image '{image}' of {owner} is cut off: the end of its file {file} is missing. Copy"
            " or save it again.",
            "A download or a copy that stopped leaves such a file. Blender shows the rest grey.",
            "途中で止まったコピーで残るファイルです。Blender では残りが灰色になります。",
        ),
        Advice(
            "The image '{image}' of {owner} has several layers or views, and Blender gives no"
            " pixels of it: save one as an image (Image > Save As), and choose that file.",
            "In the Image Editor, choose layer and pass in the header, then save as OpenEXR.",
            "画像エディターのヘッダーでレイヤーとパスを選び、OpenEXR で保存します。",
        ),
        Advice(
            "The image '{image}' of {owner} has pixels that are not finite numbers: repair it.",
            "They come from a render that divided by nothing. Save it anew as PNG.",
            "計算に失敗したレンダーに含まれることがあります。PNG で保存し直します。",
        ),
        Advice(
            "The picture '{picture}' is no flat rectangle: choose a flat plane for it.",
            "Add > Mesh > Plane is one. Scale it, but do not move its corners.",
            "追加 > メッシュ > 平面 を使います。拡大縮小はできますが、角は動かしません。",
        ),
        Advice(
            "The picture '{picture}' is no flat rectangle, so that where the viewers disagree it is"
            " blended: choose a flat plane for one sharp picture.",
            "Places on a plane can be compared between viewers; on other shapes colours alone can.",
            "平面なら、絵の位置を視点の間で比べられます。ほかの形では色しか比べられません。",
        ),
        Advice(
            "The picture '{picture}' is seen edge-on: turn it to the viewer.",
            "Look through the viewer while you turn it.",
            "「視点から見る」で見ながら回します。",
        ),
        Advice(
            "The viewer '{viewer}' does not see the picture '{picture}', {why}.",
            "Turn the camera to the glass, or move the picture into its view.",
            "カメラをガラスに向けるか、絵を視野の中に動かします。",
        ),
        Advice(
            "No file is chosen: choose an image.",
            "Click a file in the list before you press the button.",
            "ボタンを押す前に、一覧でファイルをクリックします。",
        ),
        Advice(
            "The {n} files that are chosen are no sequence: choose one image, or files whose names"
            " differ by consecutive numbers alone.",
            "Click one file, or select the frames of one sequence without a gap, as by a box.",
            "1つのファイルをクリックするか、1つの連番画像のフレームを、抜けのないように（ボックス選択などで）選択します。",
        ),
        Advice(
            "There is no file {path}: choose an image.",
            "It was moved or renamed since the list was read.",
            "一覧を読み込んだ後で、移動または名前が変更されました。",
        ),
        Advice(
            "The file has no image '{image}': open it from its own file.",
            "It was removed from this .blend meanwhile.",
            "その間に、この .blend から削除されました。",
        ),
        Advice(
            "{owner} has no UV map: unwrap it, so that pixels have a place.",
            "In Edit Mode press U, and choose Unwrap. A new plane has a map.",
            "編集モードで U を押し、展開します。新しい平面には UV マップがあります。",
            alike=(
                "{owner} has a UV map with numbers that are not finite: unwrap it again.",
                "{owner} has a UV map without area: unwrap it again.",
            ),
        ),
        Advice(
            "The picture '{name}' has no pixels: choose an image.",
            "The image is empty, or its file is gone.",
            "画像が空か、ファイルがありません。",
            alike=("The picture has no pixels: choose another image.",),
        ),
        Advice(
            "{owner} has a black level of {black_level:g}: set one from 0 to below 1.",
            "A driver may have set it.",
            "ドライバーが設定していることもあります。",
        ),
        Advice(
            "'{picture}' keeps its shape, for {why}.",
            "Scale the plane by hand: its shape should be that of the image.",
            "平面を手で拡大縮小し、画像と同じ縦横比にします。",
            alike=(
                "it shows no image",
                "it has no UV map",
                "its UV map does not lay the image out as one rectangle",
                "its mesh is turned within the object: scale it by hand in Edit Mode",
            ),
        ),
    ),
)

RESULT = Section(
    "The result",
    "結果",
    (
        Advice(
            "The display stays dark: {remedy}.",
            "Look at the red lines over the viewport: they end where the light is lost.",
            "ビューポートの赤い線を見ます。線の終わりが、光の失われる場所です。",
        ),
        Advice(
            "The display stays dark: {share} of the picture's light goes through gaps in the glass"
            " '{glass}': close them.",
            "Select Faults, in the first panel, selects the open edges. F fills them.",
            "最初のパネルのボタンで、開いた辺を選択できます。F を押すと面が張られます。",
        ),
        Advice(
            "The viewer '{viewer}' sees nothing of the picture, whatever is shown: move it, or turn"
            " it off in the list of viewers.",
            "It may look past the picture, or through the plate from too far aside.",
            "絵のそばを見ているか、プレートに対して斜めすぎるのかもしれません。",
        ),
        Advice(
            "The frame of the viewer '{viewer}' cuts off {share} of the picture: turn it to the"
            " picture, or give it a wider view.",
            "A shorter Focal Length, or a larger Orthographic Scale, of the camera sees more. The"
            " coverage that is told is of the rest.",
            "カメラの「焦点距離」を短くするか、「平行投影のスケール」を大きくします。"
            "表示される割合は、残りの部分のものです。",
        ),
        Advice(
            "{share} of the picture's light goes through gaps in the glass '{glass}' ({n} open"
            " edges): close them.",
            "Select Faults, in the first panel, selects them. F fills them.",
            "最初のパネルのボタンで選択できます。F を押すと面が張られます。",
        ),
        Advice(
            "{share} of the picture's light is caught in the glass, however high Max Events is:"
            " look for faces that lie in one another, or for a hollow that touches the outside.",
            "Move walls that share a place apart by a tenth of a millimetre.",
            "同じ場所にある壁を、0.1 mm ほど離します。",
        ),
        Advice(
            "{share} of the picture's light meets more than {most} surfaces and is cut off: raise"
            " Max Events.",
            "Max Events is under Solve > Settings. It costs time only where light needs it.",
            "「計算 > 設定」にあります。必要な光にだけ時間がかかります。",
        ),
        Advice(
            "{share} of the view is off by more than the tolerance, or lost, where it changes"
            " within a viewer pixel: {remedy}.",
            "This is the light of cut edges. A larger tolerance hides the remark, not the light.",
            "カットの稜線の光です。許容誤差を上げても、表示が消えるだけで光は変わりません。",
        ),
        Advice(
            "{share} of the light meets gaps or overlaps of glass that are thinner than the mesh's"
            " own error, and may go another way: use the same mesh for faces that touch, or move"
            " them apart.",
            "A liquid in a glass is best made of the glass's own inner faces.",
            "グラスの中の液体は、グラスの内側の面をそのまま使って作ります。",
        ),
        Advice(
            "Blender rounds places: landings may be off by {error} display pixels, and glass nearer"
            " than {gap} touches. Move the rig to the origin, and the origins of its objects to"
            " their middles.",
            "Object > Set Origin > Origin to Geometry does the second.",
            "オブジェクト > 原点を設定 > 原点をジオメトリへ移動 を使います。",
        ),
        Advice(
            "The mesh costs up to about {error} display pixels, for {remedy}.",
            "More faces, by a Subdivision Surface modifier, make it less.",
            "サブディビジョンサーフェスで面を増やすと、小さくなります。",
        ),
        Advice(
            "{share} of the picture's light meets normals of '{part}' that contradict its faces,"
            " and lands elsewhere in renderers such as Cycles: mark edges there sharp (Shade Smooth"
            " by Angle), or subdivide.",
            "Text that was shaded smooth around its corners is the usual case: real glass has sharp"
            " edges there.",
            "角までスムーズシェードにしたテキストがよくある例です。実物のガラスでは、そこに稜線があります。",
        ),
        Advice(
            "The normals of {n} smooth triangle{s} of '{part}' contradict the shape or are missing,"
            " so that light follows the flat facets there. Mark edges there sharp (Shade Smooth by"
            " Angle), or subdivide.",
            "It is right to leave it, where the glass is cut flat.",
            "ガラスが平らにカットされている場所では、そのままでかまいません。",
        ),
        Advice(
            "The mesh of '{part}' is too irregular or too coarse to tell the curved surface in"
            " {drawn} of its smooth faces, which are followed as drawn; {curved} are followed as"
            " curved.",
            "Surface: Smooth, in the panel Object, follows all of it as curved.",
            "「オブジェクト」パネルの「サーフェス」で、すべてを曲面として扱えます。",
        ),
        Advice(
            "'{part}' is followed as drawn: its mesh is too irregular or too coarse to tell the"
            " curved surface.",
            "A Remesh and a Subdivision Surface modifier make a scan regular.",
            "スキャンデータは、リメッシュとサブディビジョンサーフェスで整えられます。",
        ),
        Advice(
            "{share} of the source image is brighter than a display's white and would be clipped:"
            " {remedy}, or export OpenEXR, which keeps it.",
            "The setting is in the panel Object, when the picture is selected.",
            "絵を選択すると、「オブジェクト」パネルにこの設定があります。",
        ),
        Advice(
            "Glare: {share} of the light that the viewer gets comes beside the glass, {where}:"
            " {remedy}.",
            "A dark card on the bench does the same for real light.",
            "実際の装置では、黒い板で光をさえぎることもできます。",
        ),
        Advice(
            "{share} of the source image is wanted darker than the black of '{display}', which"
            " shines {black_level} of its white: it stays that bright. Raise the Picture Brightness"
            " of '{picture}', or take a display of less Black Level.",
            "An OLED display has a Black Level of 0.",
            "有機 EL ディスプレイの黒レベルは 0 です。",
        ),
        Advice(
            "The display stays dark.",
            "Nothing of the picture arrives, and no single reason stands out: look at the red"
            " lines.",
            "絵の光がまったく届きません。原因は一つではありません。赤い線を見ます。",
        ),
        Advice(
            "The source image has {width} x {height} pixels, the display '{display}'"
            " {display_width} x {display_height}: solve again.",
            "The display's resolution was changed after the solve.",
            "計算の後で、ディスプレイの解像度が変わりました。",
        ),
        Advice(
            "No pixel of the display '{display}' shows the picture alone, so that nothing can be"
            " compared: raise its resolution.",
            "Report measures pixels that see nothing but the picture.",
            "「レポート」は、絵だけを表示するピクセルで測ります。",
        ),
    ),
)

FITTING = Section(
    "Sizes and places",
    "大きさと場所",
    (
        Advice(
            "'{name}' keeps its size, for {why}.",
            "Free it and press the button again, or scale it by hand.",
            "動かせるようにしてからもう一度押すか、手で拡大縮小します。",
            alike=(
                "'{name}' keeps its size, for it is an instance.",
                "'{name}' keeps its size, for it is linked from another file.",
                "'{name}' keeps its place, for {why}.",
                "'{name}' cannot be turned, for it is an instance.",
                "it is an instance",
                "it is animated",
                "its place is locked",
                "its scale is locked",
                "a constraint or a driver holds it",
                "its parent '{parent}' is scaled unevenly",
                "it has no size",
                "it is not flat",
                "its mesh is turned within the object, and is no square",
            ),
        ),
        Advice(
            "{owner} is not flat: its size is for you to choose.",
            "Only flat plates and displays are fitted.",
            "自動で合わせられるのは、平らなプレートとディスプレイだけです。",
            alike=(
                "The size of the plate '{plate}' is for you to choose, for the display '{display}'"
                " is not flat.",
            ),
        ),
        Advice(
            "Hardly any of the picture '{name}' gets through about its middle: move it, or turn the"
            " glass.",
            "Best Place looks for a place for you.",
            "「最適な配置」が場所を探します。",
        ),
        Advice(
            "No light of the picture comes to the plane of the display '{name}': move or turn it.",
            "Follow the lines over the viewport: the display has to stand where they lead.",
            "ビューポートの線をたどります。ディスプレイは、線の先に置きます。",
            alike=(
                "No light of the picture comes to the display by way of the plate '{name}': move or"
                " turn it.",
            ),
        ),
        Advice(
            "The picture is in the viewer's own pixels and has no size of its own: choose a picture"
            " plane.",
            "Set Picture to Plane, in the panel Rig, and give a plane the role Picture.",
            "「リグ」パネルの絵を平面に切り替え、平面に役割「絵」を設定します。",
            alike=(
                "The picture is in the viewer's own pixels and moves with it: choose a picture"
                " plane.",
            ),
        ),
        Advice(
            "All of the picture arrives: there is nothing to bring back.",
            "This is good news.",
            "問題はありません。",
        ),
        Advice(
            "The scene has changed since '{label}' looked at it: press it again.",
            "What it found holds for the scene as it was then.",
            "見つかった結果は、そのときのシーンのものです。",
        ),
        Advice(
            "The picture '{picture}' is behind the viewer: turn the viewer round.",
            "The camera looks along its own -Z: the triangle over it shows where up is.",
            "カメラは自分の -Z の向きを見ます。上の三角形が上の向きです。",
        ),
        Advice(
            "No place within {angle:.0f} degrees shows {share} of the picture, the best one {best}:"
            " enlarge the display{plate}, or ask for less.",
            "Share is among the button's own settings, at the lower left of the view.",
            "割合は、ビューの左下に出るボタンの設定で変えられます。",
        ),
        Advice(
            "The viewer '{viewer}' sees nothing of the picture from its own place: move it, or"
            " enlarge the display.",
            "Visible Range shows from where the picture is seen.",
            "「可視範囲」で、絵がどこから見えるか分かります。",
        ),
        Advice(
            "The limit {limit:g} is no angle: set one above 0 arcmin.",
            "Limit is among the button's own settings, at the lower left of the view.",
            "限度は、ビューの左下に出るボタンの設定で変えられます。",
        ),
        Advice(
            "The share {share:g} is none: set one above 0, up to 1.",
            "Share is among the button's own settings, at the lower left of the view.",
            "割合は、ビューの左下に出るボタンの設定で変えられます。",
        ),
        Advice(
            "From its own place the viewer '{viewer}' sees the picture off by more than {limit}"
            " arcmin, as others ask for it elsewhere: raise Limit, or its weight.",
            "Result > Viewers tells by how much each of several viewers sees it displaced.",
            "「結果」の「視点」に、視点ごとのずれが表示されます。",
        ),
    ),
)

PLATE = Section(
    "The plate",
    "プレート",
    (
        Advice(
            "The plate '{plate}' has no area: scale it up.",
            "Fit Plate gives it the size that the light needs.",
            "「プレートを合わせる」で、光に必要な大きさになります。",
        ),
        Advice(
            "The plate '{plate}' is not flat: a plate has to be a plane.",
            "Apply no modifier that bends it.",
            "曲げるモディファイアーは使えません。",
        ),
        Advice(
            "The x axis of the plate '{plate}' does not lie in the plate, but its mirrors stand at"
            " 45 degrees to that axis: turn its mesh, and apply its scale.",
            "Object > Apply > Scale, and turn the mesh in Edit Mode.",
            "オブジェクト > 適用 > スケール を行い、編集モードでメッシュを回します。",
        ),
        Advice(
            "The plate '{plate}' is {width:g} mm wide, less than the {pitch:g} mm from mirror to"
            " mirror: scale it up or lower its pitch.",
            "The scene may be in metres where millimetres were meant.",
            "ミリメートルのつもりのシーンが、メートルになっているかもしれません。",
        ),
        Advice(
            "{owner} has a {name} of {value:g} mm: set one above 0.",
            "A driver or a script set it. A product sets all of the plate's numbers anew.",
            "ドライバーやスクリプトが設定した値です。製品を選び直すと、すべての値が設定されます。",
            alike=(
                "{owner} has mirrors with a reflectance of {reflectance:g}: set one above 0, up to"
                " 1.",
                "{owner} has an index of refraction of {ior:g}: set one of 1 or more.",
                "{owner} has layers crossed {angle:g} degrees wrong: set at most {most:g}.",
                "{owner} has one layer only, which cannot be crossed wrong: set the crossing error"
                " to 0.",
                "{owner} has a phase that is no number: set one in pitches.",
            ),
        ),
        Advice(
            "The rig has no plate that could be '{plate}': leave out --plate.",
            "A rig behind the glass has none.",
            "「ガラスの向こう」のリグにはプレートがありません。",
        ),
        Advice(
            "'{name}' is not flat, as a plate has to be: deselect it for a new plane.",
            "With nothing selected, the button makes a plane with the material.",
            "何も選択しないと、マテリアルの付いた平面が作られます。",
            alike=(
                "'{name}' has no faces: give it some, or deselect it for a new plane.",
                "'{name}' is linked from another file: make it local first.",
            ),
        ),
        Advice(
            "The file {file} is missing or broken: install Kiriko again.",
            "Part of the extension's folder was deleted.",
            "エクステンションのフォルダーの一部が削除されています。",
            alike=("The file {file} has no material '{name}': install Kiriko again.",),
        ),
    ),
)

CALIBRATION = Section(
    "Calibration",
    "キャリブレーション",
    (
        Advice(
            "The points are not in the order of a lattice of {columns} x {rows}: number them by"
            " column and row, or set the lattice that was shown.",
            "Columns and rows are in the panel Calibration: Lattice.",
            "列と行は「キャリブレーション：格子」パネルにあります。",
        ),
        Advice(
            "Some points are hardly where they belong: {problems}. Correct that, or leave them"
            " out.",
            "Points that are left out cost nothing, as long as many stay.",
            "多くの点が残っていれば、除いても問題ありません。",
        ),
        Advice(
            "The points are mirrored or turned: count columns from the left and rows from the top,"
            " and hold the camera as the viewer looks.",
            "Some cameras write mirrored images of their front side.",
            "前面カメラの写真は、左右が反転していることがあります。",
        ),
        Advice(
            "The photograph seems to show the picture {way}: hold the camera as the viewer looks,"
            " show the whole lattice, or name each point in a CSV file.",
            "Look whether the display shows the image turned.",
            "ディスプレイの画像が回転していないか確かめます。",
        ),
        Advice(
            "The {n_points} points do not form the lattice of {columns} x {rows}: choose another"
            " photograph, or name each point in a CSV file.",
            "Take it in a dark room, with nothing bright beside the glass.",
            "暗い部屋で、ガラスのそばに明るいものを置かずに撮影します。",
        ),
        Advice(
            "{extra} of {n_points} points have no place in the lattice of {columns} x {rows}:"
            " remove other bright spots, or set the lattice that is shown.",
            "Cover lamps and reflections, or paint them black in the photograph.",
            "照明や反射を隠すか、写真の中で黒く塗ります。",
        ),
        Advice(
            "The viewer sees too little of the lattice to tell its points apart: compare its"
            " columns, rows and margin with the picture.",
            "Show Lattice makes a new one by the numbers in the panel.",
            "「格子を表示」で、パネルの値から作り直せます。",
        ),
        Advice(
            "No point is seen near its expected place, so that the points cannot be told apart:"
            " name each point in a CSV file.",
            "Or bring the bench nearer to the drawing first.",
            "または、まず装置を図面に近づけます。",
        ),
        Advice(
            "The photograph is turned by about 45 degrees, so left and upper cannot be told apart:"
            " turn it.",
            "Level the camera.",
            "カメラを水平にします。",
        ),
        Advice(
            "Too few of the {columns} columns and {rows} rows are seen to number them: show more"
            " of the lattice, or name each point in a CSV file.",
            "Make the picture smaller, so that all of it arrives.",
            "絵を小さくして、全体が届くようにします。",
        ),
        Advice(
            "No lattice of bright {marks} was found in the photograph: take a sharp one that shows"
            " more of the lattice.",
            "Set the style, dots or lines, to the one that is shown.",
            "点か線か、表示しているものにスタイルを合わせます。",
        ),
        Advice(
            "A photograph of {size} pixels is too small to find points in: take a larger one.",
            "Send it as a file: messengers shrink photographs.",
            "ファイルとして送ります。メッセージアプリは写真を縮小します。",
        ),
        Advice(
            "The scene has the result of '{file}' already: solve, and take another photograph of"
            " the view.",
            "Remove Offset forgets it, if you want to begin anew.",
            "最初からやり直す場合は、「オフセットを削除」を押します。",
        ),
        Advice(
            "Nothing may be off: set a tolerance above 0.",
            "They are under May Be Off.",
            "「キャリブレーション：写真」の下の「ずれの見込み」にあります。",
        ),
        Advice(
            "Only {n_shown} of {n_points} points of the lattice are seen in this rig: compare its"
            " columns, rows and margin with the picture.",
            "Press Show Lattice and Solve once more, with the numbers as they are now.",
            "今の値のまま、もう一度「格子を表示」と「計算」を押します。",
        ),
        Advice(
            "'{file}' has {width:.0f} x {height:.0f} pixels, the viewer {viewer_width:.0f} x"
            " {viewer_height:.0f}: give the viewer's resolution the photograph's shape.",
            "Only the shape counts: 600 x 400 will do for a photograph of 6000 x 4000.",
            "縦横比だけが大切です。6000 x 4000 の写真なら、600 x 400 で十分です。",
        ),
        Advice(
            "There is nothing to calibrate by: choose a photograph or a CSV of points.",
            "The field is Measured.",
            "「キャリブレーション：写真」パネルの最初の欄、「測定値」です。",
        ),
        Advice(
            "The photograph has {width} x {height} pixels: give both numbers, or 0 for both.",
            "They are asked for with a CSV only: a photograph has its own.",
            "CSV の場合にだけ必要です。写真は自分の値を持っています。",
        ),
        Advice(
            "Only {n_measured} points were measured: a fit takes {least} or more.",
            "Show a lattice of more points, or a photograph that shows more of it.",
            "点の多い格子を表示するか、もっと広く写った写真を使います。",
        ),
        Advice(
            "Only {n_used} of {n_left} measured points can be followed to the display: look for"
            " swapped points, for points of another rig, or for glass with many flat faces.",
            "Solve first, and look whether the picture arrives there at all.",
            "まず計算して、絵がその場所に届いているか確かめます。",
            alike=(
                "The points lie {off:.3g} pixels from every place where the rig can show them: look"
                " for swapped points, or for points of another rig.",
            ),
        ),
        Advice(
            "The fit still changes after {steps} steps: look for wrong or swapped points, compare"
            " the lattice with the picture, or lower the tolerances.",
            "The likely errors are under May Be Off: set to 0 those that you know.",
            "「ずれの見込み」で、わかっている値を 0 にします。",
        ),
        Advice(
            "A lattice of {columns} x {rows} points is too small: take 2 or more each way.",
            "Columns, rows and border are in the panel Calibration: Lattice.",
            "列、行、縁は「キャリブレーション：格子」パネルにあります。",
            alike=(
                "A lattice cannot have a margin of {margin:g}: set one from 0 to below 0.5.",
                "{columns} x {rows} points do not fit into {width} x {height} pixels: take fewer"
                " points, or {pixels:.0f} pixels.",
                "A margin of {margin:g} would cut the outer points: set one of half a spacing,"
                " {half:.2g}.",
            ),
        ),
        Advice(
            "The file '{path}' does not begin with the names column, row, x, y, or x, y: add that"
            " line.",
            "A CSV is a text: names in the first line, then a line for each point, with commas.",
            "CSV はテキストです。1 行目に名前、続いて 1 点を 1 行に、コンマで区切って書きます。",
            alike=(
                "The file '{path}' is no text: choose a CSV file of points.",
                "The file '{path}' is no CSV file, see line {line} ({why}): repair it.",
                "The file '{path}' has no points: choose another one.",
                "In the file '{path}' {missing} is missing, so that its points cannot be told"
                " apart: complete it, or name the points (column, row, x, y).",
                "{where} has {n_cells} of {n_columns} columns: complete or remove it.",
                "{where} has '{text}' where a number should be: correct it.",
                "{where} has '{text}', which is no finite number: correct or remove the line.",
            ),
        ),
        Advice(
            "{where} has a point ({column:g}, {row:g}), but columns run from 1 to {columns} and"
            " rows from 1 to {rows}: correct it.",
            "Columns count from the left and rows from the top, both from 1.",
            "列は左から、行は上から、どちらも 1 から数えます。",
            alike=("{where} has the point {point} of line {line} again: remove one.",),
        ),
        Advice(
            "'{name}' cannot be set as fitted, for a constraint, a parent or shared data moves it:"
            " keep the offset instead.",
            "With the offset, Kiriko solves for the bench as it is, and no part moves.",
            "オフセットのままでも、実際の装置に合わせて計算されます。部品は動きません。",
            alike=(
                "'{name}' is an instance, and cannot be moved alone: keep the offset instead.",
                "'{name}' is linked from another file, and would not stay as it is set: keep the"
                " offset.",
                "'{name}' is animated, and would not stay as it is set: keep the offset instead.",
            ),
        ),
        Advice(
            "The calibration's offset names '{part}', which this rig does not have: calibrate"
            " again, or remove the offset.",
            "The part was deleted or renamed since.",
            "その部品は、その後で削除されたか、名前が変わりました。",
        ),
    ),
)

FILES = Section(
    "Files and memory",
    "ファイルとメモリ",
    (
        Advice(
            "The path '{path}' is relative to this file, which was never saved: save it or choose"
            " another.",
            "A path that begins with // is one beside the .blend.",
            "// で始まるパスは、.blend と同じ場所を指します。",
        ),
        Advice(
            "The folder '{folder}' cannot be written ({why}): choose another one.",
            "Folders of the system, and of read-only disks, are not yours to write.",
            "システムのフォルダーや読み取り専用のディスクには書き込めません。",
        ),
        Advice(
            "The file '{path}' cannot be written ({why}): check the disk or choose another name.",
            "Close the program that has it open, and make room on the disk.",
            "開いているプログラムを閉じ、ディスクの空きを増やします。",
        ),
        Advice(
            "The file '{path}' cannot be written ({why}): check the disk.",
            "Make room on the disk. A file that was there before is still whole.",
            "ディスクの空きを増やします。前からあったファイルは、そのまま残っています。",
        ),
        Advice(
            "The file '{file}' cannot be written ({why}): choose another folder.",
            "Give --out a folder of your own.",
            "--out に、ご自身のフォルダーを指定します。",
            alike=(
                "The copy '{file}' cannot be written as a whole: the disk may be full, free some"
                " of it or choose another folder.",
            ),
        ),
        Advice(
            "The path '{folder}' has no room for such a name ({why}): choose another.",
            "Names may have about 250 letters, fewer on some disks.",
            "名前は 250 文字ほどまでです。ディスクによっては、もっと短くなります。",
        ),
        Advice(
            "The file '{path}' cannot be read ({why}): choose another one.",
            "Open it in the Image Editor to see whether Blender can.",
            "画像エディターで開けるかどうか確かめます。",
        ),
        Advice(
            "The file '{path}' exists already: choose another name or allow overwriting.",
            "Overwrite is beside the file's name; headless it is --overwrite.",
            "ファイル名の近くに上書きの設定があります。コマンドでは --overwrite です。",
        ),
        Advice(
            "The image '{path}' cannot be read ({why}): choose another file.",
            "Save it anew as PNG in an image editor.",
            "画像エディターで、PNG として保存し直します。",
        ),
        Advice(
            "The image '{path}' is broken ({why}): choose another file.",
            "It was not written to its end: copy it again.",
            "最後まで書き込まれていません。もう一度コピーします。",
        ),
        Advice(
            "This Blender's Python has no OpenImageIO, which reads and writes the files: {remedy}.",
            "Blenders of some distributions lack it; those of blender.org have it.",
            "blender.org の Blender にはあります。ほかの配布元のものには、ない場合があります。",
        ),
        Advice(
            "The file '{path}' is not whole after writing: check the disk.",
            "The disk is full, or its network is gone. Do not use that file.",
            "ディスクが一杯か、ネットワークが切れています。そのファイルは使わないでください。",
        ),
        Advice(
            "{work} would take about {needed} GB of memory, but {free} GB are free: {remedy}.",
            "Half the resolution of the viewer takes a quarter of it.",
            "視点の解像度を半分にすると、4 分の 1 になります。",
        ),
        Advice(
            "The preview could not be written whole to the folder for temporary files, '{folder}':"
            " make room on its disk and try again.",
            "The folder is in Preferences > File Paths > Temporary Files.",
            "プリファレンス > ファイルパス > 一時ファイル で変えられます。",
        ),
        Advice(
            "Cycles wrote no preview: look in the console for its reason.",
            "A graphics card without room is the usual one: set Cycles to CPU.",
            "多くは GPU のメモリ不足です。Cycles のデバイスを CPU にします。",
        ),
        Advice(
            "The export has no path: choose a file.",
            "File, in the panel Export, is empty.",
            "「エクスポート」パネルのファイル欄が空です。",
        ),
        Advice(
            "The scene has changed since: solve again, or export the old image with"
            " allow_stale=True.",
            "In the window, Export asks instead.",
            "ウィンドウでは、代わりに確認が表示されます。",
        ),
        Advice(
            "{first}{rest}; try 'kiriko --help'.",
            "blender --background FILE --command kiriko --help lists all verbs.",
            "blender --background FILE --command kiriko --help で一覧を表示します。",
        ),
        Advice(
            "A photograph is of one rig: name it by --rig.",
            "The rigs' names are those of their collections in the outliner.",
            "リグの名前は、アウトライナーのコレクションの名前です。",
        ),
        Advice(
            "Of frames only source images are written: leave out --preview, --simulate and"
            " --viewers.",
            "Without --frames the frame that the file shows is solved, with all images.",
            "--frames がなければ、現在のフレームのすべての画像が書き出されます。",
        ),
        Advice(
            "{option} would do nothing without {needed}: add {needed}, or leave out {option}.",
            "A movie, a log and placeholders are of frames, a test card is of a movie, and zips of"
            " an atlas are for its job.",
            "動画・ログ・プレースホルダーはフレームのための、テストカードは動画のための、"
            "アトラスの zip はジョブのためのオプションです。",
        ),
        Advice(
            "The scene has no rig that Add Rig made: leave out --rig.",
            "A rig that was made by roles alone has no name.",
            "役割だけで作ったリグには名前がありません。",
        ),
        Advice(
            "The scene '{name}' has no such rig; there is one in {names}: choose a scene by"
            " --scene, before --command.",
            "The scene is the one that was shown as the file was saved. A rig's name by --rig tells"
            " its scene, too.",
            "シーンは、ファイルの保存時に表示していたものです。"
            "--rig のリグの名前でも、シーンが決まります。",
        ),
        Advice(
            "No .blend file was loaded: name an existing file before --command.",
            "Blender says nothing when it does not find the file: look at its path.",
            "Blender は、ファイルが見つからなくても何も言いません。パスを確かめます。",
        ),
        Advice(
            "'{text}' is no list of frames: write numbers and ranges with commas between, such as"
            " 1,5,10-20 or 1-250:2, which is every second one.",
            "'scene' stands for the scene's own range and step.",
            "scene と書くと、シーンの範囲とステップになります。",
            alike=(
                "The frames '{part}' are no range: begin with the smaller number, with a step of 1"
                " or more.",
                "The frames '{part}' are beyond {most}, the last that Blender has.",
            ),
        ),
        Advice(
            "This Blender has no encoder for {codec}: {remedy}.",
            "Blender 4.2 has H.264, AV1 and FFV1; newer ones have H.265 and ProRes, too.",
            "Blender 4.2 には H.264、AV1、FFV1 があり、新しい版には H.265 と ProRes もあります。",
            alike=(
                "{codec} takes no images of {width} x {height} pixels, for their sides have to be"
                " even: choose {others}, or another size of the display.",
                "Blender cannot write the movie '{path}' ({why}): check the disk, or choose another"
                " codec.",
                "The movie '{path}' has {found} frames in place of {n}: check the disk.",
            ),
        ),
        Advice(
            "The name '{name}' has a folder in it, and is that of files alone: leave out all before"
            " the last slash, and the slash.",
            "On the command line the folder is that of --out.",
            "コマンドラインでは、フォルダーは --out で指定します。",
            alike=(
                "The name '{name}' becomes '{text}', which has a folder in it, and is that of files"
                " alone: leave out what stands for it.",
            ),
        ),
        Advice(
            "Blender takes the braces in the name '{name}' for a template, which it does not know:"
            " leave them out, or double each to have the brace itself.",
            "Blender 4.5 and later read fps in braces, for one, as the frame rate. Blender 4.2"
            " takes braces as they are.",
            "Blender 4.5 以降は、波かっこに入れた fps をフレームレートのように読みます。"
            "4.2 では、波かっこはそのまま使われます。",
        ),
        Advice(
            "A movie is made of frames in the display's own numbers: choose PNG or TIFF as their"
            " format.",
            "The format is that of the panel Export, or of --format.",
            "形式は「エクスポート」パネルか --format で選びます。",
            alike=(
                "The frame '{file}' has {found} pixels, the display {size}: remove it, or solve it"
                " anew.",
                "The movie would lack frames: {told}",
                "The frames have no name: choose a file, such as //frames/source_####.",
                "The movie has no path: choose a file.",
                "The playback sets frames, too: stop it first.",
            ),
        ),
        Advice(
            "Rig '{rig}': {error}",
            "Every task of that rig, or of that viewer, would end so: no job is written.",
            "そのリグまたは視点のすべてのタスクがこのエラーで終わるため、ジョブは書き出されません。",
            alike=("Viewer '{viewer}': {error}",),
        ),
        Advice(
            "Frame {frame}: {error}",
            "The other frames are made; the same command makes those that are missing.",
            "ほかのフレームは作られています。同じコマンドが、足りないフレームを作ります。",
        ),
        Advice(
            "The file '{path}' is there already: choose another or set Overwrite.",
            "Overwrite is in the panel Export, and at the right of the file browser; headless it is"
            " --overwrite.",
            "上書きは「エクスポート」パネルと、ファイルブラウザーの右側にあります。コマンドでは"
            " --overwrite です。",
            alike=("The folder '{folder}' has {files} already: choose another or {remedy}.",),
        ),
        Advice(
            "{button} has no path: choose a file.",
            "The field of the name is empty.",
            "名前の欄が空です。",
            alike=(
                "The maps have no folder: choose one.",
                "The report has no folder: choose one.",
            ),
        ),
        Advice(
            "This Blender's Python has no OpenImageIO, which writes .exr: choose other formats, or"
            " {remedy}.",
            "Blenders of some distributions lack it; those of blender.org have it.",
            "blender.org の Blender にはあります。ほかの配布元のものには、ない場合があります。",
        ),
        Advice(
            "The file '{path}' of earlier maps cannot be removed ({why}): remove it yourself.",
            "Another program has it open, or its folder is read-only.",
            "ほかのプログラムが開いているか、フォルダーが読み取り専用です。",
        ),
        Advice(
            "No format is chosen for the maps: choose one or more.",
            "The formats are at the right of the file browser.",
            "形式はファイルブラウザーの右側にあります。",
            alike=(
                "Overscan is {overscan:g} %: set it from 0 to {most:g}.",
                "The maps for ffmpeg cannot be {times} times as large as the display: set 1, 2 or"
                " 4.",
                "The mesh step is {step:g} display pixels: set 1 or more.",
            ),
        ),
        Advice(
            "The picture '{picture}' has {width} x {height} pixels, and the maps for ffmpeg,"
            " {times} x, have room for {most}: set a smaller ffmpeg Size, or other formats.",
            "OpenEXR has no such bound.",
            "OpenEXR にはこの制限がありません。",
        ),
        Advice(
            "The preview's border is empty: left has to be less than right, and bottom less than"
            " top.",
            "Ctrl B in the camera view draws a new one; Ctrl Alt B removes it.",
            "カメラビューで Ctrl B を使うと描き直せます。Ctrl Alt B で消えます。",
        ),
        Advice(
            "The preview '{file}' would be neither .png nor .exr: choose one of these.",
            "The suffix of the name chooses the format.",
            "拡張子が形式を決めます。",
        ),
        Advice(
            "The preview needs Cycles, but only {engines} is there: enable it.",
            "Preferences > Add-ons > Cycles Render Engine.",
            "プリファレンス > アドオン で Cycles Render Engine を有効にします。",
        ),
        Advice(
            "No browser was found: open the file '{page}'.",
            "The manual is a folder of files: any browser opens it, without a network.",
            "マニュアルはファイルのフォルダーです。ネットワークがなくても、どのブラウザーでも開けます。",
        ),
    ),
)

FARM = Section(
    "A farm",
    "レンダーファーム",
    (
        Advice(
            "{n} of {whole} images are missing in '{folder}' ({names}{more}): run their tasks"
            " again.",
            "A task that failed tells its reason in its log; one that is run again leaves alone"
            " what is there.",
            "失敗したタスクのログに理由があります。もう一度実行しても、すでにある画像は変わりません。",
        ),
        Advice(
            "The image '{path}' has {width} x {height} pixels, and the first of its job has {first}"
            " x {second}: remove it and run its task again.",
            "It may be left of an earlier job with another display.",
            "別のディスプレイを使った以前のジョブのものかもしれません。",
        ),
        Advice(
            "The job has one task only: give it frames, rigs or values.",
            "A single image needs no farm: solve does it.",
            "画像 1 枚にファームは要りません。solve を使います。",
        ),
        Advice(
            "{n} tasks cannot share the places of the head: set 1 to {most}.",
            "As many tasks as the farm has workers are enough.",
            "タスクは、ファームのワーカーと同じ数で十分です。",
        ),
        Advice(
            "A task of the job has no frames: set 1 or more for each.",
            "As many frames as take some minutes are a good task.",
            "数分で終わるフレーム数が適当です。",
        ),
        Advice(
            "The job has values of no property: name one by --vary.",
            "Both options are given, or none: --vary kiriko.tolerance --values 0.1 0.2.",
            "--vary kiriko.tolerance --values 0.1 0.2 のように、両方を指定します。",
            alike=(
                "The job has no values of the property '{path}': give some by --values.",
                "The viewers of a job are those of one rig: {remedy}.",
            ),
        ),
        Advice(
            "The job has {n} values, and a task parameter takes {most}: make several jobs.",
            "Open Job Description sets this bound.",
            "Open Job Description の上限です。",
            alike=(
                "The job's list of frames has {n} letters, and a parameter takes {most}: give"
                " ranges, or make several jobs.",
            ),
        ),
        Advice(
            "The name '{text}' has two braces, which a job reads as a parameter: rename it.",
            "Open Job Description has no way to write them otherwise.",
            "Open Job Description では、ほかの書き方がありません。",
        ),
        Advice(
            "This Kiriko lacks its file '{name}', so that it cannot be packed for the farm: name"
            " its zip.",
            "Install Kiriko from its zip, or name the zip by --zip.",
            "Kiriko を zip からインストールするか、--zip で zip を指定します。",
            alike=(
                "There is no zip '{path}': name one that is there.",
                "The file '{path}' is no zip of Kiriko, or a broken one: name another.",
                "Two zips are called '{name}': rename one of them.",
                "The zip '{path}' has Kiriko {version}, and this is {own}: name the zip of {own}.",
            ),
        ),
        Advice(
            "The folder '{folder}' has results of an earlier job, which the tasks would leave as"
            " they are: move or remove '{results}' in it, or choose another folder.",
            "A task leaves images that are there, so that one that was killed may be run again.",
            "タスクは、すでにある画像を変えません。途中で止まったタスクを、もう一度実行できるようにするためです。",
        ),
        Advice(
            "The job has no folder: choose one.",
            "All workers have to see it, or the scheduler copies it.",
            "すべてのワーカーから見えるフォルダーにするか、スケジューラーがコピーします。",
            alike=(
                "The job's copy of '{file}' would replace the file itself: choose another folder.",
            ),
        ),
        Advice(
            "The file has no property '{path}' that could be set: name it as in"
            ' objects["Glass"].kiriko.ior, or kiriko.tolerance of the scene.',
            "Copy Full Data Path, by a right click on the setting, has it behind bpy.data.",
            "設定を右クリックしてフルデータパスをコピーすると、bpy.data の後ろにあります。",
            alike=(
                "The property '{path}' has {n} numbers: set one of them, '{path}[0]' to"
                " '{path}[{last}]'.",
                "The property '{path}' cannot be '{text}': give it a value of its kind.",
                "The property '{path}' cannot be {value}: give it a value from {low} to {high}.",
                "The property '{path}' has no room for {n} letters: give it {most} at most.",
            ),
        ),
    ),
)

ANY = Section(
    "Any button",
    "どのボタンでも",
    (
        Advice(
            "{work} needs more memory than there is{why}; {state}: lower the resolution of display"
            " or viewer, or raise the tolerance.",
            "Close other programs. Half the resolution takes a quarter of the memory.",
            "ほかのプログラムを閉じます。解像度を半分にすると、メモリは 4 分の 1 になります。",
        ),
        Advice(
            "{work} could not read or write a file ({text}); {state}: check the disk.",
            "The disk may be full, or a network drive gone.",
            "ディスクが一杯か、ネットワークドライブが切れています。",
        ),
        Advice(
            "{work} was stopped, for undo or a script removed data that it needs: start it again.",
            "Nothing is lost but its own work.",
            "失われたのは、その途中の計算だけです。",
        ),
        Advice(
            "{work} failed ({kind}: {text}); {state}: please report this with the file and the text"
            " in the console.",
            "This is a fault of Kiriko's. On Windows, Window > Toggle System Console shows the"
            " text; else start Blender from a terminal.",
            "Kiriko の不具合です。コンソールは、Windows では"
            " ウィンドウ > システムコンソール切り替え で開きます。"
            "ほかのシステムでは、端末から Blender を起動します。",
        ),
    ),
)

ATLAS = Section(
    "Atlas",
    "アトラス",
    (
        Advice(
            "{n} places of the head are too few: with {there} of them {axis}, blending is"
            " {off:.3g} px off: set a larger tolerance, a smaller box, or more places (where light"
            " is chaotic no number is enough).",
            "Look at the glass through the viewer first: where its image breaks up at a small"
            " movement, no map between two places is right.",
            "先にビューアーからガラスを見ます。わずかな動きで像が崩れる所では、"
            "2つの位置の間のマップは正しくなりません。",
            alike=(
                "{n} places of the head are too few: the corners of its box are {corners}.",
                "With {n} places of the head blending is {off:.3g} px off: set a larger tolerance,"
                " a smaller box, or more than {most} places.",
                "With {n} places of the head blending is {off:.3g} px off, of {tolerance:g}: make"
                " it without --plan, or plan it anew with a smaller tolerance.",
                "The tolerance of the atlas is {tolerance:g} px: set one above 0.",
            ),
        ),
        Advice(
            "The head does not move: set how far it goes right, up or forward.",
            "Its box is measured from the viewer's place, along the camera's own axes.",
            "頭の範囲は、ビューアーの位置から、カメラの軸に沿って測ります。",
            alike=(
                "The head moves from {low:g} to {high:g} mm {axis}: set two numbers, the smaller"
                " one first.",
                "The head at {right:.4g}, {up:.4g}, {forward:.4g} mm is at {point}, or behind it:"
                " let it move less far.",
                "The box of the heads is {right:g} x {up:g} x {forward:g} m: set three lengths.",
                "The viewer '{viewer}' has eyes {apart:g} m apart that converge at {away:g} m: set"
                " two lengths in its camera's Stereoscopy.",
                "The viewer '{viewer}' converges at {away:g} m: set a length in its camera's"
                " Stereoscopy.",
                "The viewer '{viewer}' is orthographic and has no head that moves: set it to"
                " Perspective.",
                "The viewers are at one place and span no box: add some elsewhere, by Two Eyes or"
                " Grid.",
            ),
        ),
        Advice(
            "The folder '{folder}' has the atlas of another rig: choose another or {remedy}.",
            "Anything of the rig that moved since makes it another one.",
            "リグの何かが動くと、別のリグになります。",
            alike=(
                "The folder '{folder}' has the atlas of a head in another box: choose another"
                " folder or {remedy}.",
                "The rig is not the one that the atlas in '{folder}' was planned for: plan it"
                " anew.",
                "The folder '{folder}' has source images of another picture, or in another light:"
                " choose another folder or {remedy}.",
                "The picture, or its light, is not the one that the source images in '{folder}'"
                " were planned for: plan them anew.",
                "The atlas in '{folder}' was planned without source images: plan it anew with them,"
                " and its maps stay.",
                "The folder '{folder}' has no {index}: plan the atlas first.",
                "The atlas in '{folder}' lacks {n} of {of} places, the first is {name}: make them"
                " first.",
                "The atlas has no folder: choose one.",
            ),
        ),
        Advice(
            "The file '{path}' is no map of an atlas ({why}): remove it, and write it anew.",
            "It was changed, or copied in part; the same command makes what is missing.",
            "変更されたか、途中までしかコピーされていません。同じコマンドが、足りないものを作ります。",
            alike=(
                "The file '{path}' is no index of an atlas ({why}): choose another folder, or"
                " remove it.",
                "The file '{path}' of an earlier atlas cannot be removed ({why}): remove it"
                " yourself.",
            ),
        ),
    ),
)

SECTIONS = RIG, GLASS, PICTURE, FITTING, RESULT, PLATE, CALIBRATION, FILES, ATLAS, FARM, ANY

# Only scripts that call core by themselves meet these: Blender's fields take no such values,
# its meshes have no such faces, and a preview is made of a rig that has a viewer.
NOT_MET = {
    "The picture '{picture}' stands on a plane, and has an image for each viewer: take these away,"
    " or the plane.",
    "{owner} has faces whose corners are none of its vertices: number them from 0.",
    "{owner} has an index of refraction that is no Index: give it one such as ConstantIndex(1.49).",
    "{owner} has an index of refraction that is no number above 0: set one.",
    "The tolerance is {tolerance:g} display pixels: set one from {least:g} to {most:g}.",
    "A ray may meet {n} surfaces: allow it 1 or more.",
    "Effort is {n} rays for a viewer pixel: set a whole number from 1 to {most}.",
    "Suppress Glare is {suppress_glare:g}: set it from 0 to 1.",
    "Ghosts is '{ghosts}': set it to 'mean' or 'strongest'.",
    "Disagreement is '{disagreement}': set it to 'sharp' or 'blended'.",
    "The rig has no viewer: add a camera and make it the viewer.",
    # pieces of sentences, and the answer to Ctrl C in a terminal
    "the scene is as it was",
    "{thing} stays (Undo takes it back)",
    "{error} But {thing} stays (Undo takes it back).",
    "{work} was stopped; {state}.",
}
